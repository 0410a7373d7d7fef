"""All that makes weights: training objects, examples, recipes and trainers."""
