"""
Replace a stage
===============

Leave a stage out, change its settings, or put your own in its place. The stages and their order are
in :doc:`the full-quality render </offline/README>`, their settings in the :doc:`API
</tools/pages/api/offline>`.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from scipy.ndimage import gaussian_filter, uniform_filter1d

from panchroma import compare, offline, render, simulate, to_srgb
from panchroma.offline.stages.luminance import recover_luminance

shot = simulate("builtin:480x320", sigma=0.01)

# %%
# Every stage has settings. Where these are a ``Switch``, ``used=False`` leaves the stage out, here
# the network that corrects colour; of others take the paper's, as ``denoising=PAPER.denoising``.
unlearned = replace(offline.BEST, learned=replace(offline.BEST.learned, used=False))


# %%
# The last stages work on bands of rows. One of your own takes a band and returns it; ``halo`` says
# how many rows above and below it looks at: with too few, rows change where bands meet.
class Softer(offline.RowStage):
    halo = offline.Halo(radius=4)

    def __call__(self, band, rows):
        mean = uniform_filter1d(band.chromaticity, 9, axis=0)
        return replace(band, chromaticity=mean).rows(*rows)


# %%
# ``stages`` gets the list of these stages ("propagation", "residual", "correction", "learned") and
# returns another: here yours stands where "learned" was.
def stages(*given):
    return [Softer() if s.name == "learned" else s for s in offline.row_stages(*given)]


# %%
# The stages before are functions of the whole frame, which you call yourself: here your own takes
# the noise out of luminance.
frame = offline.clean_frame(shot.mosaic)
luminance = gaussian_filter(recover_luminance(frame.mosaic, offline.BEST.luminance), 0.6)
own = np.concatenate(list(offline.colour_bands(offline.estimate_colour(frame, luminance))))

# %%
pictures = {
    "best": render(shot),
    "no network": render(shot, preset=unlearned),
    "softer instead": render(shot, stages=stages),
    "own denoising": own,
}
_, axes = plt.subplots(1, 4, figsize=(12, 2.5), layout="constrained")
for axis, (name, picture) in zip(axes, pictures.items(), strict=True):
    print(f"{name:20}", compare(picture, shot.truth))
    axis.imshow(to_srgb(picture).pixels[:120, :160])
    axis.set(title=name, xticks=[], yticks=[])
