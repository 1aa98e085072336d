"""Eight hidden plants, what can be concealed in them, and the integrator that runs them."""
