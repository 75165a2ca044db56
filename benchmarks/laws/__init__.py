"""Laws of soft tissue and a form of meshes to test on; `benchmarks.plugin` registers them.

Other hands than the product's wrote the laws. They share with it, and with one another, no more
than the body's surface, its skinning and gravity; nothing is tuned on them.
"""
