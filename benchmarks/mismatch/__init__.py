"""Real recordings against simulations from which a documented effect was left out."""
