"""
HDR output
==========

Render an over-exposed shot, and save it as a JPEG that an HDR display shows with its highlights.
"""

from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt

import panchroma

# %%
# One stop too much light: panchromatic pixels saturate, and colour sites, which get a third of the
# light, do not. ``best`` computes luminance from them; the published method cannot.
shot = panchroma.simulate("builtin:480x320", light=2)
pictures = {preset: panchroma.render(shot, preset=preset) for preset in ("paper", "best")}

# %%
# One stop darker, so that a screen shows the highlights:
_, axes = plt.subplots(1, 2, figsize=(12, 4.2), layout="constrained")
for axis, (name, picture) in zip(axes, pictures.items(), strict=True):
    axis.imshow(panchroma.to_srgb(picture, exposure=-1))
    axis.set(title=name, xticks=[], yticks=[])

# %%
# Ultra HDR is a JPEG with a gain map. EXR and NPY keep linear light, and so do JPEG XL and TIFF of
# 32 bits.
folder = Path(mkdtemp())
pictures["best"].save(folder / "leaves.jpg", format="uhdr")
pictures["best"].save(folder / "leaves.exr")
for path in sorted(folder.iterdir()):
    print(path.name, path.stat().st_size // 1024, "KiB")
