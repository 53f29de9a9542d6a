"""Control laws. A law computes brake enables from a valid twist."""
