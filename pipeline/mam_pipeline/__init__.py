"""From a photograph or a static mesh to an articulated, checked asset."""
