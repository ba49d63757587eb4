"""jaxleg: how should a quadruped stand and step on this ground to spend the least energy?"""
