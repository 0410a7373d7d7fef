"""Robot arms: how each reaches, grips and is commanded; kinematics from their URDF files."""
