"""Policies: what answers observations with actions, from files of many kinds or from code."""
