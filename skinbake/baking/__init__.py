"""From a look to its bake: what is read, the stages, where their results are kept, the manifest and the picture.

`bake_look` runs a look into its folder; `light_look` and `diffuse_file` do a part of that, `dry_run` says what would be
done. `stages/` has one object a stage; `look_stages` puts those of a look together.
Results are kept by a `ResultStore`: a bake folder (`folder_store`) or memory (`memory_store`). `inputs` reads the
look's files, `stage_log` takes the time and tells the terminal, `session` is what looks baked one after another share.
"""
