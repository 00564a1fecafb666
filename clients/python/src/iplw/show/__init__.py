"""How things look in a notebook: HTML with SVG in it, whole in itself, without scripts, light or dark as the page is.

| file | what |
|---|---|
| `page` | the card that everything comes in, its colours, tables |
| `drawing` | scenes, and the ways of bodies through them |
| `chart` | small charts: lines, intervals, bars |
"""
