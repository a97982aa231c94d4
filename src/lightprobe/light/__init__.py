"""Environment radiance in, prefiltered radiance levels out: cubemaps, equirectangular maps and the prefilter operator."""
