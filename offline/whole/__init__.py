"""Stages that look at the whole frame, in order: noise defects trust highlights luminance denoising chromaticity pooling."""
