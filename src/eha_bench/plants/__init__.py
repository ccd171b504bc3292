"""Plants: equations, the effects that can be added to them, and the compiled kernels of both."""
