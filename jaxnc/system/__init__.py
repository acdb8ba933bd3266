"""The compiled mechanism: static topology, differentiable parameters, residual and Jacobian."""
