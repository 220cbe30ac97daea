"""Formats of reports for CI systems. Each module is the option of its name, declared in `mjrun.options.report`."""
