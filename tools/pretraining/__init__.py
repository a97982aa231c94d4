"""Random solids of random materials, to teach what photos of objects have in common."""
