"""Evaluation of policies on tasks: seeded episodes, returns and endings with intervals, comparisons, videos."""
