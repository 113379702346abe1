"""Writing of pictures, previews and illustrations, in all output formats."""
