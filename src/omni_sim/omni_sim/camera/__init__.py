"""Simulation of line cameras: exposure times, gray levels of the pixels, and noise.

`camera.py` computes a line from the ground texture with `footprint/integral.py` and `optics.py`, in
this order, and adds noise. `batches.py` calls the cameras in every control period.
"""
