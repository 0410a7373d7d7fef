"""The joint solvers of the paper MotionAnymesh, beside the embedded one that measures better."""
