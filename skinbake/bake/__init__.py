"""From a look to its folder: which stages are stale, their runs, their files, the manifest and the picture."""
