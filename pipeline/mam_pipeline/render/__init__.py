"""Pictures of meshes by Open3D's ray casting on the CPU: no display, no driver."""
