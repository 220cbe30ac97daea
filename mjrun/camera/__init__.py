"""Cameras: rigs, scripts, motion and calibration. Mathematics; nothing is drawn here."""
