"""Objects that nobody made, to teach what photos of objects have in common: random solids of random
materials.
"""
