"""The lint of models: present faults and likely ones."""
