"""Training of the networks in `offline/models`; `offline.stages.colour_network` and
`luminance_network` run them. Needs PyTorch.
"""
