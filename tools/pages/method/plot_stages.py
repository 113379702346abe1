r"""
How the render works
====================

One crop of a shot on its way from samples to colour: the equations of the paper, and their names in
the code. :doc:`/offline/README` has every equation, and where we depart from it.

======================  =============================  ===========================================
paper                   code                           meaning
======================  =============================  ===========================================
:math:`m[n]`            ``mosaic.signal``              samples, scene units: white is 1
:math:`l[n]`            ``frame.luminance``            luminance, what a panchromatic pixel reads
:math:`\gamma_i`        ``calibration.gamma``          weight of channel i in luminance
:math:`c_i[n]`          ``chromaticity``               channel i over luminance
:math:`c_{i,j}`         ``frame.blocks``               chromaticity of block j
:math:`\alpha_j[n]`     ``solve_affinities``           how far pixel n belongs to block j
:math:`\sigma_z`        ``calibration.noise``          noise of a sample
======================  =============================  ===========================================
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import panchroma
from panchroma.offline import BEST, PAPER, clean_frame, measure, render, row_stages
from panchroma.offline.stages.affinity import solve_affinities
from panchroma.offline.stages.chromaticity import estimate_chromaticities
from panchroma.offline.stages.denoising import denoise_luminance
from panchroma.offline.stages.luminance import recover_luminance

CROP = slice(0, 96), slice(0, 144)


def show(**pictures):
    """Show the crop of each picture: grey if (H, W), colour if (H, W, 3)."""
    _, axes = plt.subplots(1, len(pictures), figsize=(12, 8 / len(pictures)), layout="constrained")
    for axis, (name, picture) in zip(np.atleast_1d(axes), pictures.items(), strict=True):
        # scene units: a panchromatic pixel reads 3 in white
        light = picture if picture.ndim == 3 else np.repeat(picture[..., None] / 3, 3, axis=2)
        axis.imshow(panchroma.to_srgb(light.astype(np.float32)).pixels[CROP])
        axis.set(title=name.replace("_", " "), xticks=[], yticks=[])


def shown(blocks):
    """Chromaticities of the blocks in the crop as colours of one brightness."""
    return 0.9 * blocks[:17, :25]


# %%
# Samples
# -------
# A panchromatic pixel reads luminance, a site one channel of it:
#
# .. math:: \sum_i \gamma_i\, r_i[n] = l[n] \qquad \text{(Eq. 7)}
shot = panchroma.simulate("builtin:480x320", light=1)
codes = shot.mosaic.codes.copy()
codes[9:96:16, 14:144:24] = 4095  # hot pixels, which a sensor has
mosaic = panchroma.shared.Mosaic(codes, shot.pattern, shot.calibration)
filters, samples = shot.pattern.filter_map(shot.shape)[..., None], mosaic.signal[..., None]
coloured = np.where(filters == 3, samples / 3, (filters == np.arange(3)) * samples)
show(scene=shot.truth.rgb, samples=coloured)

# %%
# Noise, defects, highlights
# --------------------------
# Not in the paper. ``clean_frame`` takes the noise model of the calibration or estimates it,
# replaces outliers such as these hot pixels, and computes clipped luminance from the colour sites.
frame = clean_frame(mosaic)
show(samples=mosaic.signal, cleaned=frame.signal)

# %%
# Luminance
# ---------
# Wavelets :math:`f_i` fill the sites: coefficients shrink, and the measured samples come back, with
# a threshold that falls from one iteration to the next.
#
# .. math:: l = \arg\min_l \sum_i | f_i * l |_{TV}, \qquad
#           w^*_i = \max(0, s_i - \beta^t)\, w_i / s_i, \quad s_i = \sqrt{k * w_i^2}
#           \qquad \text{(Eqs. 1-5)}
#
# ``best`` lets a network correct what was filled (``luminance_network``), and takes the noise out
# (``denoise_luminance``: a threshold, then Wiener gains, of DCT blocks that overlap).
filled = recover_luminance(frame.mosaic, BEST.luminance)
luminance = denoise_luminance(filled, frame.mosaic, BEST.denoising)
show(samples=frame.signal, filled=filled, denoised=luminance)

# %%
# Colour of blocks
# ----------------
# The sites of a block, and the constraint of Eq. 7, give one chromaticity; noise draws it to grey:
#
# .. math:: c = \arg\min \sum_i \bigl( \sum_{n_i} (l\, c_i - m)^2 + \sigma_z^2 (c_i - \bar\gamma)^2
#           \bigr), \quad \sum_i \gamma_i c_i = 1 \qquad \text{(Eqs. 6-9)}
#
# followed by medians in four directions. ``best`` asks a network of blocks instead
# (``block_network``), which sees similar blocks too (``pooling``).
measured = measure(mosaic)
paper = estimate_chromaticities(replace(frame, luminance=luminance), PAPER.chromaticity)
show(paper=shown(paper), best=shown(measured.blocks))

# %%
# Pooling
# -------
# Not in the paper. In noise the sums of Eqs. 8-9 are averaged over blocks that are alike
# (``pooling``). Here a sixteenth of the light:
dark = panchroma.simulate("builtin:480x320", light=1 / 16).mosaic
single = replace(BEST, pooling=PAPER.pooling)  # none
alone, pooled = measure(dark, single).blocks, measure(dark).blocks
show(each_block_alone=shown(alone), pooled=shown(pooled))

# %%
# Affinity
# --------
# A pixel belongs to a block as far as no edge of luminance lies between them. Four fields, one for
# each parity class of blocks, are shown as one; blocks are 1 in their own field.
#
# .. math:: \alpha = \arg\min \sum_{n, n'} c[n,n'] (\alpha[n] - \alpha[n'])^2, \quad
#           c[n,n'] = \exp(-\max(e[n], e[n'])) \qquad \text{(Eqs. 11-13)}
alpha = solve_affinities(measured.luminance, shot.pattern, BEST.affinity)
top, left = (before for before, _ in measured.grid.padding)
fields = np.moveaxis(alpha.reshape(4, *alpha.shape[2:])[:3, top:, left:], 0, 2)
show(luminance=measured.luminance, affinity=fields)

# %%
# Propagation
# -----------
# A pixel mixes the four blocks around it, and gets its colour:
#
# .. math:: c[n] = \sum_j \kappa_j[n]\, c_j, \quad \kappa_j \propto \alpha_j^2[n]\, l[n_j], \quad
#           x_i[n] = c_i[n]\, l[n] \qquad \text{(Eqs. 10, 14, 17)}


def first(count, mosaic=mosaic):
    """Render with the first stages in rows alone."""
    return render(mosaic, stages=lambda *given: row_stages(*given)[:count]).rgb


names = [stage.name for stage in row_stages(measured, BEST)]
print(names)
show(scene=shot.truth.rgb, propagation=first(1))

# %%
# Refinement
# ----------
# ``paper`` averages chromaticity over pixels whose surroundings look alike, twice. ``best`` does
# not: its blocks have little noise left.
#
# .. math:: c^+[n] = \sum \kappa_n[n']\, c[n'] / \sum \kappa_n[n'], \quad
#           \kappa_n[n'] = l[n'] \exp(-d / 2 h^2) \qquad \text{(Eqs. 15-16)}
show(
    without=render(mosaic, PAPER, stages=lambda *given: row_stages(*given)[:1]).rgb,
    paper=render(mosaic, PAPER).rgb,
)

# %%
# Correction and network
# ----------------------
# Not in the paper. At a site the picture predicts a sample; the residual corrects luminance where
# it is uncertain, otherwise colour (``correction``). Then a network corrects chromaticity
# (``colour_network``; see :doc:`/offline/models/README`).
show(**{name: first(count + 1) for count, name in enumerate(names) if name != "residual"})

# %%
# Shading
# -------
# A lens darkens the corners, and colours them. Eq. 7, noise and saturation hold for the samples as
# they are, and so shading is undone last (``shading``).
shaded = panchroma.simulate("builtin:480x320", light=1, shading=(2, 15)).mosaic
count = len(row_stages(measure(shaded), BEST))
show(before=first(count - 1, shaded), shading_undone=first(count, shaded))
