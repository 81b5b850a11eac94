"""Diffuse MPI, predicted from the scene's own geometry.

The light that reaches a pixel after its direct light is, in a room, a tail: many surfaces light each other. Read in this order:

    settings    what is asked for            grid          rays, and the patches that a frame is cut into
    light       a patch's data               choice        which model: is there a tail, or are there second_paths, by even_paths
                                                           or smoothness?
    planes      a patch's surface            beyond, box   surfaces outside the view: continued, and guessed
    radiosity   light between the patches    tail, prior   H_h(state): the model, its Jacobian, and what rooms are like
    noise       of the data                  model_error   what the model gets wrong
    condition   Gaussian conditioning        patch_fit     the state of frame and patches, by patch_steps
    through     what lets light through, before walls that are seen beside it
    leaning     what two harmonics miss      coarse        what the patches hand to the pixels
    upsampling  from patches to pixels       pixels        a pixel's answer, or that of through_pixels
    predict     a frame's model, all of the above          records       what comes out

`compiled_fit` is the front of compiled twins; `elementary` holds functions that all of it stands on.
"""
