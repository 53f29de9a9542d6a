"""Generators of pages: references of commands and parameters, status of the dissertation."""
