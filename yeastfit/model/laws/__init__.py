"""The source's laws, one file each: who buds, where and when, what moves a node, what cells eat.

Rules beyond the source's are in the folder `mechanisms`.
"""
