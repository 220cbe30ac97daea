"""Failures of the process that checks a model, rather than faults in the model."""

from mjrun.check.rule import Rule

MISSING_MODEL = Rule("MJ001", "error", "no such model file")
CRASH = Rule("MJ002", "error", "MuJoCo crashes")
TIMEOUT = Rule("MJ003", "error", "check exceeds the time limit")
OUT_OF_MEMORY = Rule("MJ004", "error", "check exceeds the memory limit")
INTERNAL_ERROR = Rule("MJ005", "error", "mjrun failed to check it")
NOT_FIXED = Rule("MJ007", "error", "fault that is not fixed")
