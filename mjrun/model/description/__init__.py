"""What a compiled model is, kind by kind, as typed plain values."""
