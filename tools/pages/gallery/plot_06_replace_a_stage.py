"""
Replace a stage
===============

Leave a stage out, change its settings, or put your own in its place.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
from scipy.ndimage import uniform_filter1d

import panchroma
from panchroma.offline import BEST, Halo, RowStage, row_stages

shot = panchroma.simulate("builtin:480x320", sigma=0.01)

# %%
# Every stage has settings, and ``used=False`` leaves it out: here the network that corrects colour.
unlearned = replace(BEST, learned=replace(BEST.learned, used=False))


# %%
# A stage of your own takes a band of rows and returns it. ``halo`` says how many rows above and
# below it looks at.
class Softer(RowStage):
    name = "softer"
    halo = Halo(radius=4)

    def __call__(self, band, rows):
        mean = uniform_filter1d(band.chromaticity, 9, axis=0)
        return replace(band, chromaticity=mean).rows(*rows)


# %%
# ``stages`` gets the list of stages and returns another: here yours stands where "learned" was.
def stages(frame, settings):
    return [Softer() if s.name == "learned" else s for s in row_stages(frame, settings)]


pictures = {
    "best": panchroma.render(shot),
    "without the network": panchroma.render(shot, preset=unlearned),
    "softer in its place": panchroma.render(shot, stages=stages),
}
_, axes = plt.subplots(1, 3, figsize=(12, 3.2), layout="constrained")
for axis, (name, picture) in zip(axes, pictures.items(), strict=True):
    print(f"{name:20}", panchroma.compare(picture, shot.truth))
    axis.imshow(panchroma.to_srgb(picture).pixels[:120, :160])
    axis.set(title=name, xticks=[], yticks=[])
