"""The kinds of documents and reports whose JSON Schemas `mjrun schema` prints; imports nothing, for its help."""

DOCUMENTS = ("camera", "run", "study", "task", "eval-document", "fit-document")

ERROR = "error"  # the key of a failure in any report, and the kind of a report of nothing else

# Kind of report → the command that prints it with --json.
REPORTS = {
    "bench": "mjrun bench",
    "diff": "mjrun diff",
    "eval": "mjrun eval",
    "excite": "mjrun fit --excite",
    "fit": "mjrun fit",
    "plot": "mjrun plot",
    "sweep": "mjrun sweep",
    "verify": "mjrun trace --verify",
    "view": "mjrun view",
}
