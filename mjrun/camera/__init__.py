"""Cameras: rigs, scripts, motion and calibration. Mathematics only; nothing is rendered here."""
