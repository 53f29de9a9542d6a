"""Reports: recordings as one HTML file that people look at.

`recording` reads a bag and the files next to it, `derived` computes what no topic
carries, `document` turns it into plain values, and `page` puts those into the page of the folder
`page`, whose script draws them.
"""
