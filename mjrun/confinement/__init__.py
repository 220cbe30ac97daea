"""What a process may do that works on files nobody vouches for."""
