"""Where the arm stands, and the arm motions that carry a grasp along the joint's path."""
