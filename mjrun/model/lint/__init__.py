"""What is wrong with a model, or will be: rules over its XML, its compiled form and its first instant."""
