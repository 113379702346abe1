"""A camera at work: frames in, saved shots and a viewfinder out."""
