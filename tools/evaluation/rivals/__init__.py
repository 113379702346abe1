"""The rivals: a Bayer sensor under the same light, and the ways that users have to make a picture
of its mosaic.
"""
