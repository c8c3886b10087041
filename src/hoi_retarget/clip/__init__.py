"""A recorded interaction: people, objects, contacts, and the work on them before retargeting."""
