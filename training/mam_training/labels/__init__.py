"""Labels by eye: objects answered through the product's own questions, kept as small JSON.

They are what somebody saw in pictures, never truth. `python -m mam_training.labels ask` puts the
questions, `show` draws a label, `agree` compares two, `dataset` makes ground truth of many.
"""
