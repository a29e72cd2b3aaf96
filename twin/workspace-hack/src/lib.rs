//! No code: the manifest names features, so that a build of `ftac` alone and one of the whole workspace have the same parts.
