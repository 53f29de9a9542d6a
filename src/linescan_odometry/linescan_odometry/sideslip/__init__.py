"""Sideslip angles of wheels, from a camera beside each (section 4.6)."""
