"""Maximum-likelihood displacement of a whole batch of lines, with the camera's fixed pattern.

Line k of a batch of m lines is modeled as

    y_k(x) = b(x) + g_k(x + X_k) + e_k(x),    X_k = d kappa_k + a kappa_k^2 / 2,

with kappa_k = k - (m - 1) / 2, a fixed pattern b of the camera, a ground texture g that loses its
coherence from line to line as a first-order autoregressive process (the line drifts sideways onto
new ground), and white noise e. The unknowns are the displacement d per line [px] and its change a
[px per line^2]. The pattern is subtracted from the lines, and their spectra are shifted into the
ground frame. At every spatial frequency f these are Gaussian along the lines:

    z_k = Y_k(f) exp(-2 pi i f X_k) ~ N(0, T),    T_kj = S rho^|k - j| + N delta_kj.

The pattern is Gaussian too, with a mean and a variance at every frequency that are updated by each
batch. The mean is subtracted and the variance marginalized. So the variance of the displacement
increases where a pattern may imitate the motion: in slow motion over a coarse ground.
"""
