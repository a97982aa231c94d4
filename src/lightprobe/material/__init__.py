"""Surface points in, glTF metallic-roughness material out: a hash-grid field while training, textures
afterwards.
"""
