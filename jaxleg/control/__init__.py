"""What moves the joints: controllers, the same ones in every engine.

A controller is a pytree, its numbers and plans leaves, that fills in `contract.Controller`: it starts with a memory, and at
each tick turns what is sensed into the motors' command. Three stand here: `tracking` (a reference, open loop), `course`
(feedback on the trunk's place over a long plan) and `reflex` (a swing leg that feels its way). All are one lane; `vmap` them.
"""
