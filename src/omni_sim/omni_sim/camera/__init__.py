"""Line cameras: exposure times, mean gray level of each pixel's footprint, noise.

A line is computed from the texture by `footprint/integral.py`, `optics.py` and `exposure.py`, which
`camera.py` calls in this order. `batches.py` calls the cameras in every control period.
"""
