"""A small room to play in, with a hostile title: a variant for each test that needs one."""

EVIL = "<img src=x onerror=window.hacked=1>"
SHELF, SHELF_TOP = (-1.5, 0.5), 0.5  # [m]
DRIVES = "".join(f"\n      - drive_to: {{x: {x}, y: -0.3}}" for x in 40 * (0.9, 0.3))  # 3 min: outlasts a test
TEXT = f"""
format: motm-scene/1
title: "{EVIL}<script>window.hacked=1</script>"
start: {{x: 0.0, y: 0.0}}
furniture:
  table: {{shape: box, centre: [1.6, 1.0], size: [0.8, 0.8], z: [0.0, 0.75], style: desk}}
  desk: {{shape: box, centre: [1.6, -1.4], size: [0.8, 0.8], z: [0.0, 0.6], style: desk}}
  shelf: {{shape: box, centre: [{SHELF[0]}, {SHELF[1]}], size: [0.6, 0.6], z: [0.0, {SHELF_TOP}], style: desk}}
objects:
  cube: {{surface: table, at: [1.45, 0.72]}}
bins:
  bin: {{at: [1.45, -1.2]}}
tasks:
  - pick: cube
  - place: bin
variants:
  delivery:
    furniture:
      table: {{shape: box, centre: [2.2, 1.0], size: [0.8, 0.8], z: [0.0, 0.75], style: desk}}
      desk: {{shape: box, centre: [2.2, -1.4], size: [0.8, 0.8], z: [0.0, 0.6], style: desk}}
      shelf: null
    objects: {{cube: {{surface: table, at: [2.05, 0.72]}}}}
    bins: {{bin: {{at: [2.05, -1.2]}}}}
  nothing_to_do:
    tasks:
      - drive_to: {{x: 0.0, y: 0.0}}
  long:
    tasks:
      - pick: cube
      - place: bin{DRIVES}
"""
