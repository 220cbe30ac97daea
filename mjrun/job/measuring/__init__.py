"""What `bench` measures, each cost in a module of its own; the clock is given, so that tests can give theirs."""
