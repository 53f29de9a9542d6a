"""Sideslip angles of wheels from a camera next to each (section 4.6)."""
