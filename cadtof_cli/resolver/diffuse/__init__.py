"""Diffuse MPI, predicted from the scene's own geometry.

The light that reaches a pixel after its direct light is, in a room, a tail: many surfaces light each other. Read in this order:

    settings    what is asked for            grid          rays, and the patches that a frame is cut into
    light       a patch's data               choice        which model: is there a tail?
    planes      a patch's surface            beyond        surfaces continued outside the view
    radiosity   light between the patches    tail, prior   H_h(state): the model, its Jacobian, and what rooms are like
    noise       of the data                  condition     Gaussian conditioning, one datum after the other
    patch_fit   the state of frame and patches             coarse        what the patches hand to the pixels
    upsampling  from patches to pixels       pixels        a pixel's answer
    predict     a frame's model, all of the above          records       what comes out
"""
