"""Every option of every command, declared once: click, documents, Python and the reference are derived from it."""
