"""HTML display in notebooks: self-contained HTML with SVG, without scripts, in light or dark colours like the page.

| module | contents |
|---|---|
| `page` | the card around all displays, its colours, tables |
| `drawing` | scenes and trajectories |
| `theme` | colours |
| `chart` | small charts: lines, intervals, bars |
"""
