"""Makes the networks of `offline.learned` from photographs and drawn scenes; `offline/models/README.md` is their card."""
