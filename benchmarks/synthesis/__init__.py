"""Design by gradient: published cases, other mechanisms than four-bars, and the cost of many gradients."""
