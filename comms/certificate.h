// SPDX-License-Identifier: Apache-2.0
//
// OpenSSL's keys, certificates and signed texts, as values that free themselves. In and out as PEM
// text; who reads and writes files is the caller.
#pragma once

#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/x509.h>

#include <memory>
#include <optional>
#include <string>

namespace covey {

struct OpenSslDeleter {
  void operator()(BIO* buffer) const { BIO_free_all(buffer); }
  void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
  void operator()(X509* certificate) const { X509_free(certificate); }
  void operator()(X509_CRL* list) const { X509_CRL_free(list); }
};
using TextBuffer = std::unique_ptr<BIO, OpenSslDeleter>;
using PrivateKey = std::unique_ptr<EVP_PKEY, OpenSslDeleter>;
using Certificate = std::unique_ptr<X509, OpenSslDeleter>;
using RevocationList = std::unique_ptr<X509_CRL, OpenSslDeleter>;

// Null: the text is none.
[[nodiscard]] PrivateKey private_key_from(const std::string& pem);
[[nodiscard]] Certificate certificate_from(const std::string& pem);
[[nodiscard]] RevocationList revocation_list_from(const std::string& pem);

// These throw std::runtime_error with what OpenSSL says.
[[nodiscard]] std::string to_pem(EVP_PKEY& key);
[[nodiscard]] std::string to_pem(X509& certificate);
[[nodiscard]] std::string to_pem(X509_CRL& list);

// Throws std::runtime_error with `what` could not be done, and OpenSSL's reason.
void require_openssl(bool good, const std::string& what);

struct Subject {
  std::string team;  // O
  std::string name;  // CN
};
[[nodiscard]] Subject subject_of(const X509& certificate);  // empty where it says nothing
// As permissions name it and Fast DDS compares it (RFC 2253): "CN=uav0,O=blue".
[[nodiscard]] std::string distinguished_name(const Subject& subject);

// Why nobody would accept `certificate`: forged, expired, revoked. `revoked` may be null.
[[nodiscard]] std::optional<std::string> problem_with(X509& certificate, X509& authority,
                                                      X509_CRL* revoked);

// S/MIME with a detached signature, text/plain, the signer's certificate inside: the form of
// governance and permissions (DDS Security 1.1, 9.4.1).
[[nodiscard]] std::string sign(const std::string& text, X509& signer, EVP_PKEY& key);
// The text; none if `authority` has not signed it.
[[nodiscard]] std::optional<std::string> verified_text(const std::string& smime, X509& authority);

}  // namespace covey
