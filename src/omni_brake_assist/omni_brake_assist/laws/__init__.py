"""Control laws, one module each. A law computes brake enables from a valid twist."""
