"""Surface points in, glTF metallic-roughness material out: as a hash-grid field while training, as textures afterwards."""
