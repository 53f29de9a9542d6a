"""Maximum-likelihood estimate of the displacement of a batch and of the camera's fixed pattern.

Line k of a batch of m lines is modeled as

    y_k(x) = b(x) + g_k(x + X_k) + e_k(x),    X_k = d kappa_k + a kappa_k^2 / 2,

with the pixel x, kappa_k = k - (m - 1) / 2, a fixed pattern b of the camera, a ground texture g,
and white noise e. As the line drifts sideways onto new ground, the texture loses coherence from
line to line. This loss is modeled as a first-order autoregressive process. The unknowns are the
displacement d per line [px] and its change a [px per line^2]. The pattern is subtracted from the
lines, and the spectra Y_k of the lines are shifted into the ground frame. At every spatial
frequency f [cycles per pixel], the resulting vector over the lines is Gaussian with mean 0 and
covariance T:

    z_k = Y_k(f) exp(-2 pi i f X_k),    T_kj = S rho^|k - j| + N delta_kj.

S is the power of the texture, rho its coherence between neighboring lines, and N the power of the
noise. These three depend on the frequency; delta_kj is 1 for k = j, else 0. The pattern is also
Gaussian. Each batch updates its mean and variance at every frequency, and the mean is subtracted.

In motion, the prior variance of the pattern is the power of its estimate. At rest, ground and
pattern cannot be separated. The prior variance is then the specified non-uniformity of the pixels,
S contains only the power above the posterior variance of the pattern after earlier batches, and N
contains this variance. A batch can be at rest only if the differences of neighboring lines are
white noise.
"""
