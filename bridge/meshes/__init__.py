"""Files of registered meshes."""

from bridge.installation import require_packages_of

require_packages_of(__name__)
