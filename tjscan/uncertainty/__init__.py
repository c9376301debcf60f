"""Where the uncertainty of sections comes from: components, combined as the GUM combines them."""
