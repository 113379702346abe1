"""Makes the networks of `offline.rows.learned` from photographs and drawn scenes; `offline/models/README.md` is their card."""
