"""Reports: recordings as one HTML file.

`recording` reads a recording and the files next to it, `derived` computes quantities that no topic
contains, `document` converts them to plain values, and `page` puts these into the page of the
folder `page`, whose script draws them.
"""
