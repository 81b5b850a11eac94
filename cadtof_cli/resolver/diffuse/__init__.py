"""Diffuse MPI, predicted from the scene's own geometry.

The light that reaches a pixel after its direct light is, in a room, a tail: many surfaces light each other. Read in this order:

    settings    what is asked for            grid          rays, and the patches that a frame is cut into
    light       a patch's data               separate      patches with two separate paths, which no tail explains
    planes      a patch's surface            beyond        surfaces continued outside the view
    radiosity   light between the patches    tail          H_k(state): the model, and its Jacobian
    noise       of the data                  condition     Gaussian conditioning, one datum after the other
    patch_fit   the state of frame and patches             coarse        what the patches hand to the pixels
    upsampling  from patches to pixels       pixels        a pixel's answer          predict      all of it
"""
