"""From a drawn curve to mechanisms: chains of dyads as arrays, an atlas of their curves, fitting, ranking."""
