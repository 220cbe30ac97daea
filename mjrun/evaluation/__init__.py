"""How good a policy is on a task: seeded episodes, their returns and endings, intervals, comparisons, films."""
