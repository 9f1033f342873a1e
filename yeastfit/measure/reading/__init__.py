"""From files to grey values, pixel sizes and data sets."""
