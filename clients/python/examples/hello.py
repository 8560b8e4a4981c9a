"""The first view of a scene: python hello.py [SCENE] [PICTURE.png]"""

import sys

from PIL import Image

import argus_render

scene, picture = (sys.argv[1:] + ["terrain", "hello.png"][len(sys.argv) - 1 :])[:2]
with argus_render.open(scene) as renderer:
    Image.fromarray(renderer.render().rgb[0]).save(picture)
