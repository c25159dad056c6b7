"""Light transport inside closed skin, by random walks: what a bake is measured against."""
