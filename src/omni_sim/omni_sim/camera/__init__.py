"""Line cameras: exposure times, mean gray level of each pixel's footprint, noise.

A line is computed in the order texture -> `footprint/integral.py` -> `optics.py` -> `exposure.py`.
`camera.py` calls these modules in turn, and `batches.py` calls the cameras in every control period.
"""
