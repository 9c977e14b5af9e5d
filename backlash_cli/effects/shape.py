"""The one shape of a physical effect.

An effect is a `step` for one sample and an EFFECT record that describes it. `step(state, value, p)` takes the
effect's state (1-D float64 array, changed in place), one input sample and the parameters (1-D float64 array in the
order of EFFECT.parameters) and returns one output sample. It is plain Python within numba's subset, so that the
same lines run one sample at a time in the closed loop and compiled over whole arrays when a model is fitted.
"""
