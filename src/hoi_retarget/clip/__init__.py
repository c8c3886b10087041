"""A recorded interaction: people, objects, contacts, and what is done to them before retargeting."""
