"""Diffuse MPI, predicted from the scene's own geometry.

In a room, all surfaces light each other. The light that reaches a pixel after its direct light is a tail. Read the
modules in this order:

    settings      what is asked for
    grid          rays of pixels, and the patches that a frame is cut into
    light         the data of a patch
    choice        the model of a frame: does it have a tail, or second paths? Asks second_paths, even_paths
                  and smoothness
    planes        the surface of a patch
    beyond, box   surfaces outside the view: continued ones, and guessed walls
    radiosity     light between the patches
    tail, prior   H_h(state): the model and its Jacobian; what rooms are like
    noise         noise of the data
    model_error   what the model gets wrong
    condition     Gaussian conditioning
    patch_fit     the state of the frame and of its patches; patch_steps holds the operations on each patch
    variation     whether the data vary over the view as the tail would
    nets          surfaces that let light through, before walls that are seen beside them; walls finds these walls
    bias          the bias of two harmonics
    coarse        what the patches hand to the pixels
    upsampling    from patches to pixels
    pixels        the answer of a pixel; other_terms for a response that is no sine, net_pixels for a net
    predict       the model of a frame, from all modules above
    records       what comes out

`elementary` holds functions that the other modules stand on.
"""
