"""Figures of tables: the choice of curves, the reduction of samples to points, and drawing with matplotlib."""

import logging

logging.getLogger("matplotlib").setLevel(logging.ERROR)  # else it advises how to cache fonts in a home without room
