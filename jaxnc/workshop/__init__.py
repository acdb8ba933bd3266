"""Parts of planar mechanisms for a workshop: plates in layers, with pins and spacers between them."""
