# The functions of SciPy that mjrun uses. SciPy has no annotations that a strict check accepts.
