"""From depth pictures to surfaces: the camera, who the subject is, a mesh of what is seen."""
