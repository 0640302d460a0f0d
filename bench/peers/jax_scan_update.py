"""Updates a second of a DDPG in JAX on one thread of the CPU, many updates in each compiled call.

As `jax_update.py`, but `jax.lax.scan` does the updates of a call, so that calls cost nothing.
"""

from jax_update import main

if __name__ == "__main__":
    main(scan=True)
