"""`dsnet_plus`: coupled damped oscillators on the skin, a Keras layer, and its training."""
