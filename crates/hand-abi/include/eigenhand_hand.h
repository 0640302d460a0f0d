/* The C interface between Eigenhand and a compiled hand plugin.
 *
 * A plugin generates a hand: it is given options and yields the manifest and the files that a hand's directory would
 * hold. It is a dynamic library that exports one symbol,
 *
 *     const eigenhand_hand_plugin_t eigenhand_hand_plugin;
 *
 * Only integers, pointers to bytes with their length and C functions cross the boundary. Whatever a plugin hands out is
 * its own until `free`; whatever it is given belongs to the caller and ends with the call. The table and the functions
 * stay valid and unchanged from the moment the library is opened. No function may unwind or jump out of itself. The
 * program calls one function at a time, whatever its number of threads, and never the functions of a plugin from within
 * one. Everything is copied out at once: no code of a plugin runs while a hand is simulated.
 *
 * This file says the same as the Rust crate eigenhand-hand-abi, whose tests compare the two.
 */
#ifndef EIGENHAND_HAND_H
#define EIGENHAND_HAND_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* First field of the table, which tells it from anything else of that name. */
#define EIGENHAND_HAND_MAGIC 0x45484E44u
/* A plugin built for another major version is refused. */
#define EIGENHAND_HAND_ABI_MAJOR 1u
/* Grows when a function is appended; older plugins stay valid. */
#define EIGENHAND_HAND_ABI_MINOR 0u

/* What a function returns: EIGENHAND_HAND_OK, or any other number for a failure. */
typedef int32_t eigenhand_status;
/* The function did what it is for. */
#define EIGENHAND_HAND_OK 0
/* The function failed; for `generate`, `error_message` says why. */
#define EIGENHAND_HAND_ERROR 1
/* The function was left by a panic or an exception, which was caught inside the plugin. */
#define EIGENHAND_HAND_PANIC 2

#define EIGENHAND_HAND_EXPORT __attribute__((visibility("default")))

/* Bytes that belong to somebody else. */
typedef struct eigenhand_bytes {
    const uint8_t *data; /* first byte; may be null where len is 0 */
    size_t len;          /* number of bytes */
} eigenhand_bytes;

typedef struct eigenhand_hand_plugin_t {
    /* The first four fields, which no version of the interface changes. */
    uint32_t magic;       /* EIGENHAND_HAND_MAGIC */
    uint32_t abi_major;   /* EIGENHAND_HAND_ABI_MAJOR */
    uint32_t abi_minor;   /* EIGENHAND_HAND_ABI_MINOR */
    uint32_t struct_size; /* sizeof(eigenhand_hand_plugin_t): how many functions the plugin has */

    /* Generates a hand.
     *
     * options: options_len bytes of UTF-8, the table [options] of the plugin's sidecar as TOML, empty where there is
     * none. They belong to the caller, are valid during the call, and no zero byte ends them.
     * out: holds null before the call. The plugin writes a pointer to it that the caller gives to `free` once, also
     * where the call fails, so that `error_message` can be asked. A plugin that has nothing to say about a failure may
     * leave null there. Only the plugin knows what is behind the pointer. */
    eigenhand_status (*generate)(const uint8_t *options, size_t options_len, void **out);

    /* Writes the number of the hand's files to *out.
     *
     * hand: from a `generate` that succeeded, and `free` was not called with it. */
    eigenhand_status (*file_count)(const void *hand, size_t *out);

    /* Writes where name and content of a file are to *name and *content.
     *
     * index: smaller than the number of files.
     * name: a path below the hand's directory, in UTF-8, with `/` between its parts.
     * Both belong to the plugin, and are valid and unchanged until free(hand). */
    eigenhand_status (*file)(const void *hand, size_t index, eigenhand_bytes *name, eigenhand_bytes *content);

    /* Writes where the reason of a failure is to *out.
     *
     * hand: from a `generate` that failed. The message is UTF-8, belongs to the plugin, and is valid and unchanged until
     * free(hand). */
    eigenhand_status (*error_message)(const void *hand, eigenhand_bytes *out);

    /* Ends what `generate` made, and all bytes that were read of it. Null is allowed and does nothing. */
    void (*free)(void *hand);
} eigenhand_hand_plugin_t;

/* The one symbol that a plugin exports. */
extern EIGENHAND_HAND_EXPORT const eigenhand_hand_plugin_t eigenhand_hand_plugin;

#ifdef __cplusplus
}
#endif

#endif
