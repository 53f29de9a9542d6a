"""Reports of recordings, each as one HTML file.

`recording` reads a recording and the files next to it. `document` computes quantities that no topic
contains, converts all to plain values, and inserts these into the HTML page in the folder `page`,
whose script draws them.
"""
