"""Line cameras: exposure times, mean gray level of each pixel's footprint, noise.

Path of a line: texture -> `footprint/integral.py` -> `optics.py` -> `exposure.py`. `camera.py`
calls these in turn, and `batches.py` calls the cameras for every control period.
"""
