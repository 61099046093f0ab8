"""Director's tree viewer: requests over LCM become edits of the live tree, each answered as its clients expect."""
