"""Simulation of line cameras: exposure times, gray levels of the pixels, and noise.

`camera.py` computes a line from the ground texture with `footprint/integral.py`, `optics.py` and
`exposure.py`, in this order. `batches.py` calls the cameras in every control period.
"""
