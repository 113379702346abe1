"""Files out: pictures, previews and illustrations, in every format that can be written."""
