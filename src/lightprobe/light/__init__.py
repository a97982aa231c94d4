"""Environment radiance in, prefiltered levels out: cubemaps, equirectangular maps and the prefilter operator."""
