"""Monitors that apply all brakes, or withhold impossible inputs from a law; one module each."""
