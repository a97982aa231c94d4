"""The bundled scene: a painted coffee pot under computed lights, rendered by an independent path tracer."""
