"""The bundled scene: a painted coffee pot under lights of our own making, rendered by an independent path
tracer.
"""
