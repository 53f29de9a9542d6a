"""Sideslip angles of wheels, each measured by a camera next to the wheel."""
